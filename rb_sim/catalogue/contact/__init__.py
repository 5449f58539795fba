"""What a contact is made of: who touches what, how it rubs, and how the support moves."""
