"""What serves orip's pages and answers to this machine: who may use it, and the server of the pages."""
