"""What a case or a campaign asks of its user before it may do it."""
