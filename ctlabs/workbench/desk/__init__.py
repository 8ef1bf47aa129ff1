"""What a person does, without a page: sessions on drafts, the commands on a model, what is kept."""
