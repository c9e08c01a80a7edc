"""What a user demands of the hands over time, and how well it is met (Habibie et al. 2022, §3.1.3 and §4.2)."""
