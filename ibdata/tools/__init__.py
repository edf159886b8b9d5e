"""What is done to finished datasets, a file each: check, repair, reproduce, split, merge, list, document."""
