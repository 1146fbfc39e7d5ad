"""Systems' answers: how questions are put to them, and what their answers say."""
