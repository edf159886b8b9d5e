"""The paper's figures, one per module, with `draw(figure)`."""
