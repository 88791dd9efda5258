"""Tasks about what two cameras see together."""
