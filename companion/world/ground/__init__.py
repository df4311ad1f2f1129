"""Heights of the ground: read from files or generated, and as the planner's cells."""
