"""Cameras of simulators and scene editors: MuJoCo, USD, CoppeliaSim, Blender, Unity."""
