"""Tasks about targets: printing them, finding them in photos, taking views of them."""
