"""What is known of a project: frozen records and arrays. No maths, no files.

The assembled block and the drive table are made of what the folders `project`, `observations` and `results` hold; names
and ground coordinates belong to all of them.
"""
