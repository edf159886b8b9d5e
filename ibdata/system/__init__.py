"""What the operating system must promise."""
