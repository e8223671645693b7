"""The project folder: its text files and stores read, its outputs written.

Every command begins here; nothing here knows what a command is for.
"""
