"""Views of the same transitions: what is observed, what is rewarded, and how imperfectly it is measured.

A view is applied on reading a dataset, on exporting it, in the environments and in evaluation. In all of
them, users see the same numbers under the same names and in the same order. Nothing on disk changes.
"""
