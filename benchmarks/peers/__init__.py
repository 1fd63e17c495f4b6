"""What the working memory is measured beside; each module needs a library of the extra `bench`."""
