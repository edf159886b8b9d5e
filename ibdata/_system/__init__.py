"""Files, locks, signals, processes and storage: what the package needs from the operating system."""
