"""What has been measured: the log replayed into the stores, observations listed, edited and listed for measuring."""
