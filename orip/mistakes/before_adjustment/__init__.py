"""Mistakes that the records, the marks and the gathered block show before anything is adjusted.

Impossible cameras, marks under each other's names, points outside the frame, one photo under two names, unused names.
"""
