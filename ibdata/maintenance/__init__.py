"""Datasets made from datasets, and datasets mended."""
