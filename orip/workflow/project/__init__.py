"""The project folder: its text files and stores read, its outputs written.

Every command begins here; nothing here depends on a particular command.
"""
