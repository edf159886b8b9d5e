"""Simulation of the episodes of an experiment into columns."""
