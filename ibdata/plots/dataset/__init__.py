"""Pictures of a dataset, one a file: `draw(figure, summary)` draws, `size(summary)` is in inches."""
