"""Floor 7: results for people: the terminal summary, the HTML report and printable artwork."""
