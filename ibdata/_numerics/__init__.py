"""Arithmetic, random numbers and compilation that give the same bits everywhere."""
