"""Messages that scripts for frankapy use."""
