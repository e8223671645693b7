"""What is known of a project: frozen records and arrays. No maths, no files."""
