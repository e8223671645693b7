"""Planning a flight or a network: its geometry, its precision and reliability, and where control helps most."""
