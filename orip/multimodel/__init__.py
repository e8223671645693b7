"""Multi-model driving: the drive table, the loop equations of the plate processor, guiding systems, model switching."""
