"""Results of `calibrant verify` by a task: one file a kind."""
