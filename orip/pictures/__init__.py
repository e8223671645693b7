"""Photographs: image files and what is measured on them: tie points by matching, targets, projects from images.

Needs the packages of the extra `images`; a module imports them where it uses them. Images are never changed.
"""
