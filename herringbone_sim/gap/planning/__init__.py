"""What sensors would tell, before anything is recorded."""
