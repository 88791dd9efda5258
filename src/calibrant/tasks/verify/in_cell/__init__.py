"""Verifications in the simulated robot cell: the same work, with a robot that is there and a truth that measures."""
