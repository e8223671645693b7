"""One function for each command: the state of a project in, a change out. The only place where files and maths meet.

`project` reads states and commits changes; the other folders hold the commands on one subject each.
"""
