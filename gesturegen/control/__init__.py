"""Control of the hands: a user's conditions over time and how well they are met (Habibie et al. 2022, §3.1.3, §4.2)."""
