"""What could be observed beside a block, and which of it helps most."""
