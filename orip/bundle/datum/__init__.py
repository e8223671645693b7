"""The datum of a block: movements that nothing holds, and inner constraints that hold them."""
