"""Exponential sums Re sum_k c_k exp(lambda_k s): evaluation and certified first roots."""
