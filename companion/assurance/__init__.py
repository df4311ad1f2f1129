"""Independent check of every plan, and the emergency chain."""
