"""What is examined, and what is said of it: the case, the loop before and after, findings and how sure they are."""
