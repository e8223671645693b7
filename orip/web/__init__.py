"""What serves orip's pages and answers to this machine: who may use it, and the server of the pages."""

ANY_PORT = "127.0.0.1:0"
"""Where a page is served that nothing is said of: on this machine alone, at any port that is free."""
