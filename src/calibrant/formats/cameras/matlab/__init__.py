"""Calibrations of MATLAB: its own toolbox and that of Bouguet."""
