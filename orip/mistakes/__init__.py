"""What was probably mistaken when something was typed, named or measured: units, names, signs, the wrong photo.

`before_adjustment` looks at records, marks and the gathered block, `misread_control` at what the preliminary values
found, `explanation` at an adjustment: it adjusts the data again as they were probably meant and compares the fits.
"""
