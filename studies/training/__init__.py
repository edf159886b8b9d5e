"""Modules that several studies share: trainings, estimators, and the pages that hold their results."""
