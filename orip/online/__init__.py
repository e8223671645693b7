"""A block while it is measured: preliminary values as soon as they can be had, and an answer to each measurement.

Every measurement is tested in the sequential block before it counts. Knows no project and no files.
"""
