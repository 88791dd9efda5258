"""Depth as a colour camera sees it: noise, planes, and a depth picture brought onto the colour picture."""
