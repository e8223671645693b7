"""Measuring in the images of the photos, on a page of the browser: points, control by matching, what does not fit."""
