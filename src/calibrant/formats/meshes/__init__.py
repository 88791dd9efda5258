"""Surfaces of objects as triangles: STL and OBJ files."""
