"""Parameters from records: RLS family, output error, swarms; and what the data can tell."""
