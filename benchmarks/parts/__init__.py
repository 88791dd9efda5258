"""Parts of benchmarks that are no commands themselves."""
