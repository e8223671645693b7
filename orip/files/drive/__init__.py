"""The drive table (.DRV) as text, and what an emulated plate processor keeps over a restart."""
