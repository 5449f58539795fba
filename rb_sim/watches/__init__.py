"""What every run is watched for: balances, constraints, steps; each from what is logged alone."""
