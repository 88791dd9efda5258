"""Floor 7: a robot led by what a camera sees: control laws, conveyors. No simulator is imported."""
