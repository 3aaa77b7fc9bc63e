"""People made from MakeHuman's base mesh: shapes, garments, and bones of the house's gait."""
