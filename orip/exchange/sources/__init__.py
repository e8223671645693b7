"""How foreign files are read whatever their format: rows of text, trees of XML and JSON, members of zip files."""
