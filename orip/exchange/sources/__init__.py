"""How foreign files are read, whatever their format: lines of text, trees of XML and JSON, and their faults."""
