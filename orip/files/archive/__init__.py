"""Files of the results of an archive: what is kept of each project, and the tables made of it."""
