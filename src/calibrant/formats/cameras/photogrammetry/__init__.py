"""Reconstructions by photogrammetry: many pictures of few cameras, each with its place."""
