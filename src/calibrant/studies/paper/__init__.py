"""The paper's experiment (6-DoF pose of a cuboid by colour and depth) made again in the simulated cell."""
