"""Pictures of a dataset, one per module, with `draw(figure, summary)` and `size(summary)` in inches."""
