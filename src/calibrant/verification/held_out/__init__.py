"""Fresh views against a result: errors in px, mm and deg beside the predicted ones."""
