"""Pictures of a dataset, one per module: `TITLE`, `draw(figure, summary)`, and a docstring as the caption."""
