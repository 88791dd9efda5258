"""Projectors of a cell: lenses that are found in the whole alone, from what lights a camera's corners."""
