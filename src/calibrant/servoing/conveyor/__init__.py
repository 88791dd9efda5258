"""Moving things: where they are and will be, and a grasp on the move."""
