"""What a diagnosis answers: its verdict, where the residual sits, what it could have seen."""
