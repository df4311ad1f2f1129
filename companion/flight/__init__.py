"""The service: composition, tasks, modes, health."""
