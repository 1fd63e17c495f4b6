"""Who may take part in a working memory, and what each may write: certificates, policy, checks of what arrives."""
