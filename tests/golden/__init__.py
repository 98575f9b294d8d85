"""What users, other programs and stored data rely on, kept as data: a change of it is made on purpose."""
