"""The control texts edited by commands, and the names in them that the project does not know."""
