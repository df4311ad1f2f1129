"""Engines that make a campaign's runs: processes of this computer, or workers on several computers.

They know runs and outcomes, but neither rows nor progress.
"""
