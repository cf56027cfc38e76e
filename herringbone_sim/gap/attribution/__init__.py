"""What each effect would change, and how well it explains a residual."""
