// Work on many items in several threads.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <system_error>
#include <thread>
#include <vector>

namespace rtamt {

// Calls worker(i) for each of n items, in up to so many threads. Each thread takes blocks of items
// from one counter, and has a worker of its own: make_worker() returns one. The first exception of a
// thread ends the work, and is thrown again here.
template <class MakeWorker>
void in_threads(std::size_t n, std::size_t threads, MakeWorker make_worker) {
    const std::size_t block = std::clamp<std::size_t>(n / (8 * std::max<std::size_t>(1, threads)),
                                                      1, 256);
    threads = std::clamp<std::size_t>((n + block - 1) / block, 1, std::max<std::size_t>(1, threads));
    std::atomic<std::size_t> next{0};
    std::vector<std::exception_ptr> errors(threads);
    const auto run = [&](std::size_t thread) {
        try {
            auto worker = make_worker();
            for (std::size_t i; (i = next.fetch_add(block)) < n;)
                for (const std::size_t end = std::min(n, i + block); i < end; ++i) worker(i);
        } catch (...) {
            errors[thread] = std::current_exception();
            next = n;
        }
    };
    std::vector<std::thread> others;
    try {
        for (std::size_t thread = 1; thread < threads; ++thread) others.emplace_back(run, thread);
    } catch (const std::system_error&) {
        // The system refuses another thread: those that run do all the work.
    }
    run(0);
    for (std::thread& other : others) other.join();
    for (const std::exception_ptr& error : errors)
        if (error) std::rethrow_exception(error);
}

}  // namespace rtamt
