"""Driving in the oriented block: the drive table of a solution, and the plate processor that has it loaded."""
