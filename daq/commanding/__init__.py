"""What is commanded: single commands, plans, and the operator who holds the lease."""
