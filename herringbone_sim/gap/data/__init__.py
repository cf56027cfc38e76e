"""What was recorded, as arrays, and what is wrong with it."""
