"""Finished datasets on disk: `dataset` reads one or a selection of it, by the files that `stored` reads."""
