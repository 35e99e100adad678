"""Many runs: studies and tuning."""
