"""Space resection of one photo without initial values, from points known on the ground."""
