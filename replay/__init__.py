"""Plays recordings as if they were live, tells what is in them, and mends them."""
