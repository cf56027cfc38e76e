"""What a recording of the gear says against its model: one residual and its columns each."""
