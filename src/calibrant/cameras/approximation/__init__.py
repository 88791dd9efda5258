"""A camera said in the words of another model: exactly where these have all its terms, else as near as they come."""
