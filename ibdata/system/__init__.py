"""Files, locks, signals and storage: everything that the operating system must promise."""
