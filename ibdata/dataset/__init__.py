"""Finished datasets on disk.

`reader` has the dataset and `selection` a part of it, which read rows by the methods of `readable`. Under
them, `stored` reads the files that the manifest lists.
"""
