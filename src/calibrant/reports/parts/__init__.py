"""What kinds and pages are put together from: numbers and facts in words, rows, tables, blocks."""
