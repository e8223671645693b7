"""Files of other programs: readers and writers, a module or a folder for each format, without maths.

`formats` lists the formats; what they share is in `sources`. A project is one neutral value (`orip.records.exchanged`),
in the conventions of its program; `orip.exchange.conversion` converts it.
"""
