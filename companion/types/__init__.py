"""Frozen data types shared by all layers."""
