"""What text formats have in common: lines and fields with their places, numbers, tables, whole-file replacement."""
