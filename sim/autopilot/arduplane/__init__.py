"""arduplane."""
