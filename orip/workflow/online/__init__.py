"""`orip online`: a session of measuring, its requests, and the log that keeps what is accepted."""
