"""What occludes two surfaces from each other [SC]: shafts, candidate lists and the casting of rays through them."""
