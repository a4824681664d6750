#ifdef __cplusplus
}
#endif

#endif /* {{ upper }}_H */
