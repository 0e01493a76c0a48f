"""Who stands between two surfaces [SC]: shafts, candidate lists and the casting of rays through them."""
