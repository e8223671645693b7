"""Variance components: the a-priori errors of groups of observations, estimated from their residuals."""
