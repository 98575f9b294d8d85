"""Operations on a stored solution: export, refine, reproduce, verify, missed thrust."""
