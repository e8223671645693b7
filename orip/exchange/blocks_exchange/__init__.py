"""Blocks Exchange XML of Bentley ContextCapture and iTwin Capture."""
