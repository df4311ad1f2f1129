"""Flights whose battery falls twice as fast as told: ``make energy``. Uses the simulator and the service."""
